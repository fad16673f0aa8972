"""The tasks, one module each, registered with Gymnasium when `tvae` is imported."""
