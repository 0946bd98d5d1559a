"""Force sensors by ATI, as the Nano17: Net F/T box, Digital F/T, and gauges on a board."""
