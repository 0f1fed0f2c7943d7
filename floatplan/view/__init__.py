"""Pictures of plans: figures, films, the report and the scene."""
