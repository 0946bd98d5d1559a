"""Methods of texture modelling side by side, on the same sessions of known texture."""
