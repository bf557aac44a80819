"""How a cloth comes apart: where its threads part, along which edges it splits, and what becomes of its arrays."""
