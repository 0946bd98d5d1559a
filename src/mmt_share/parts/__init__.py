"""Parts of the leader that share its model and its control."""
