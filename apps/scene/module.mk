# tm-scene writes a first scene of a mesh, and says what is missing or odd in one.
$(eval $(call program,tm-scene,$(sort $(wildcard apps/scene/*.c)),$(SCENE_LIBS),-lyaml -lcjson))
