"""The link between follower and leader: Socket.IO over WebSocket, msgpack, 1 kHz both ways."""
