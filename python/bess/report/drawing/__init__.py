"""Drawing of charts with matplotlib, SVG and Bokeh in one style."""
