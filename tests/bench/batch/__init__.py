"""What `cape batch` costs beyond the runs that it makes."""
