"""Reading and writing files for people: errors that name the place, writes that never leave half a file."""
