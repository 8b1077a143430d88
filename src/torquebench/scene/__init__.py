"""The arm as it looks: shapes, kinematics and cameras, for films, windows and pages."""
