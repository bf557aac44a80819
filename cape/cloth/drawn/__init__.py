"""What is drawn of a cloth in place of what is simulated: a finer mesh, and images."""
