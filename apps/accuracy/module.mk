# tm-accuracy measures, page.py draws.
ACCURACY_SRC := $(sort $(wildcard apps/accuracy/*.c))
$(eval $(call program,tm-accuracy,$(ACCURACY_SRC),$(LIBAPP_A) $(LIBTM_A),-lcjson))
