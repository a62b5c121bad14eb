"""Operators' answers, from hearing one to its acknowledgement."""
