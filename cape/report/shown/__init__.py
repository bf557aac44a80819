"""What the report shows: a page, diagrams, recordings."""
