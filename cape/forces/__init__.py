"""Forces on a cloth, one file each: `registry` lists them."""
