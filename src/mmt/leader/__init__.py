"""The leader service: one file for each task, and bounded queues between tasks."""
