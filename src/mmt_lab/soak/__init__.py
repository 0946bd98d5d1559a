"""Long runs with faults: the faults, the services, and the checks that must hold."""
