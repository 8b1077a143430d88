"""The dialect in which laws and kernels are written: what may stand in their source, and what each part does."""
