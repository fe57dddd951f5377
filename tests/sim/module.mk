# test_unstable runs tm-sim in a program of its own, so that faults can be planted in its world.
$(foreach t,$(sort $(wildcard tests/sim/test_*.c)),$(eval $(call test,$(t),$(SIM_LIBS),-lyaml -lcjson)))
