# C tests are cmocka programs, one a file; Python tests drive the programs as a user would. pytest runs both.
# TM_LONG=1 (make check-long) asks tests for the counts and durations that docs quote.
$(foreach t,$(sort $(wildcard tests/unit/test_*.c tests/physics/test_*.c)),$(eval $(call test,$(t),$(LIBTM_A),)))
