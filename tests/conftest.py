"""The tests are a package (``tests.…``), so that files of one name can stand in several folders."""
