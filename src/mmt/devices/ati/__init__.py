"""Force sensors by ATI, such as the Nano17: Net F/T box, Digital F/T, and gauges on a board."""
