"""Exchanges regions of interest between vehicles, on the simulated trail: `anytraverse roi-exchange`."""
