"""What simple controllers and a learned one get from the registered environments."""
