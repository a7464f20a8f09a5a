"""`weft view`: a job's cloth in the browser, refined while one changes camera, light and fibers."""
