"""Selection of missing effects by one fit, one criterion and one loop, measured against `diagnose`."""
