"""What is measured while a cloth moves: strain, contacts, energy."""
