"""`cape live`: from the command line and the keys of a terminal to a cloth that runs."""
