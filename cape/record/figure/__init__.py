"""Who wears a cloth, a body or a robot, and what closes it."""
