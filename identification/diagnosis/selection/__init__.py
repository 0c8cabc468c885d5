"""Selection: which candidate effects the data support."""
