"""What a user describes: cloth, what holds it, what it meets, how the bones move."""
