"""The live view: a process that shows Foxglove and Lichtblick what is recorded, while it happens."""
