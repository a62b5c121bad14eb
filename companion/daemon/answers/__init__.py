"""Handles operators' answers, from their arrival to their acknowledgement."""
