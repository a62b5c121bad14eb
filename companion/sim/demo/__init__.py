"""Shows the whole job in one command, `companion demo`: field, daemon and operator run as three processes."""
