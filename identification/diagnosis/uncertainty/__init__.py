"""How well the parameters of a repaired model are known, and which absent effects the data exclude."""
