"""Small faults put into the safety path, one at a time: do the tests notice each?"""
