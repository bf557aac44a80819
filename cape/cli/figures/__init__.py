"""How commands tell figures: in rows of a table, and as JSON has them."""
