"""How fabrics look: weaves, colours, and the textures made of them."""
