"""Show, record and serve what the daemon does: the supervisor's ends and their processes."""
