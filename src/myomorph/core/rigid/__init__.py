"""The model as flat arrays and the kernels over frames. Knows neither muscles nor markers."""
