"""Force feedback over a delay: on recorded contacts, and in a closed loop."""
