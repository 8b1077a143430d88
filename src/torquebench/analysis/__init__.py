"""What is made of stored runs: figures and reports. Importing this package imports no plotting library."""
