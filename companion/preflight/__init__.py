"""`companion check`: what a person should know before the vehicle is trusted to the companion."""
