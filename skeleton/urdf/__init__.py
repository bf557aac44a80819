"""A robot's URDF file as a Pinocchio model: its bones, which role each plays, which joints follow others."""
