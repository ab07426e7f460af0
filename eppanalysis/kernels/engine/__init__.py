"""The event-exact engine, compiled."""
