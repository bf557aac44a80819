"""What a time step costs, and what it is worth: error against run time for the standard scenes and every solver."""
