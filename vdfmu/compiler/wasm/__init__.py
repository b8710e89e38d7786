"""Systems as WebAssembly, written without a compiler: traced functions, and the module that they are put into."""
