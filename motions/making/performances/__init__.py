"""Idle, jump, kick and spin, composed from kinematics: feet that stand where they stand, a centre of mass that obeys.

Each performance says where its feet are, how trunk and arms turn and where the centre of mass goes; `figure` does the
rest. Times [s], angles [degrees] and places [m] were chosen and then judged by eye; the jump's flight is free fall.
"""
