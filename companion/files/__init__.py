"""What the ground may read: a small tree of files, made on demand or lying in folders of the rover.

`from companion.files.tree import Tree`.
"""
