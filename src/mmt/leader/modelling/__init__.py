"""Modelling beside the rendering: four tasks, joined by bounded queues."""
