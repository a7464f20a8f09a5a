"""Everything that speaks OpenGL: context, buffers, shader text, programs. moderngl is imported here only."""
