"""Pictures of every artifact on the way to cloth: `weft preview`. Only plotter.py loads pyvista."""
