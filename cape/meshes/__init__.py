"""Any triangle mesh as a garment: read, cleaned, remeshed, worn, and drawn finer than it is simulated."""
