"""The leader service: one file a task, joined by bounded queues."""
