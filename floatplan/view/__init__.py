"""The pictures: figures, tables and exports of a plan."""
