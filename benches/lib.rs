//! Benchmarks of the Rust kernels (`cargo bench`), in a package of their own: tests need not compile their library.
