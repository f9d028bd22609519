"""One description of a figure, drawn by Matplotlib or Plotly."""
