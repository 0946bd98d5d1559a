"""Long runs with faults: what is done to the services, and what must hold all the same."""
