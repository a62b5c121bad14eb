"""Bundles: folders of networks that a workstation writes once and a rover runs."""
