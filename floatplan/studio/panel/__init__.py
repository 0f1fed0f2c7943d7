"""The panel: sliders, choices and buttons, and what the page says."""
