"""A cloth's motion as that of a few joints in chains, which its vertices follow by weights: what game engines play."""
