"""Reads, writes and checks bundles: folders of networks that a workstation writes and a rover runs."""
