"""What is measured. Each module has a function `measure`, which a child process calls with the arguments of a case."""
