"""A model shared with listeners: messages, server, clients, hubs, control and the player."""
