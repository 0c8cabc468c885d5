"""Film of a cradle in, angles of its bobs and a described experiment out."""
