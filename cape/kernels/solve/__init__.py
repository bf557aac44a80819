"""What all solvers share in a frame, and symplectic Euler."""
