"""How charts are drawn: what a chart is, and its way to matplotlib, to SVG and to Bokeh, in one style."""
