"""The operator's side: one protocol client, and the terminal that sits on it.

Needs pymavlink and nothing heavier, so that it also installs where a ground station lives.
"""
