"""What the vision process costs, and what its death costs: nothing that was acknowledged."""
