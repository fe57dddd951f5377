# What tm-evaluate and tm-accuracy replay samples with.
LIBREPLAY_A := $(OUT)/lib/libreplay.a
LIBRARIES += $(LIBREPLAY_A)
$(LIBREPLAY_A): $(call objects,$(sort $(wildcard apps/studies/replay/*.c)))
	$(archive)
