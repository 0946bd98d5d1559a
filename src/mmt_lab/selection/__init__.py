"""Sample selection on simulated trials with planted knocks: published against ours."""
