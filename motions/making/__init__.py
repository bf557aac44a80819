"""How the shipped clips are made: `python -m motions.making.make`."""
