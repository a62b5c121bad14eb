"""The whole job in one command: `companion demo`. Field, daemon and operator are processes of their own."""
