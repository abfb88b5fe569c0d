"""Problems with known answers (`cards`) and hard cases (`stability`), for tests, benchmarks and pages alike."""
