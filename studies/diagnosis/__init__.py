"""How often a diagnosis is right: effects hidden by an independent simulator, and what the diagnosis names."""
