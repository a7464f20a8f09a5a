"""`weft inspect FILE`: what is in a file, whoever wrote it."""
