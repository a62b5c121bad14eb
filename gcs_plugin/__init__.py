"""Implements the operator's side: the protocol client, a terminal and a MAVProxy module that use it.

Needs pymavlink and nothing heavier, so that it also installs into a ground station's environment.
"""
