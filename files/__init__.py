"""Reading and writing files for people: errors that name the place, and writes that never leave half a file."""
