"""`cape batch`: many clips, a process each, on this machine or on those of a cluster."""
