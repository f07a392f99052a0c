"""Reading programs into moves: G-code, points, NURBS and DXF."""
