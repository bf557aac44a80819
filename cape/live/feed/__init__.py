"""From the physics to a viewer, that can't make it wait: a mailbox, and the process that empties it."""
