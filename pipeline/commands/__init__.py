"""The commands of `weft`, a file per group; a module adds its commands to the app when imported."""
