"""Messages of the live monitor's page, which also shows recordings, its viewers, and orders."""
