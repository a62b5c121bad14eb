"""Counts the calls of whole drives in virtual time, by who answers them."""
