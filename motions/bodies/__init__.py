"""Who is who among the joints of a body, and how tall it is: by names, and by its shape."""
