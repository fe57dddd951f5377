# image.so: images by ITK and GDCM (which ITK's package brings), tetrahedra by CGAL (GPL), for tm-mesh image and fill. Optional: `make image` installs the two and builds it; nothing else waits for it.
IMAGE_SRC := $(sort $(wildcard apps/image/*.cpp))
IMAGE_SO := $(OUT)/lib/tensormass/image.so
ITK_LIBS = $(foreach n,ITKIONIFTI ITKIONRRD ITKIOMeta ITKIOImageBase ITKCommon itksys,-l$(n)-$(ITK_VERSION))
ITK_VERSION = $(patsubst ITK-%,%,$(notdir $(firstword $(wildcard /usr/include/ITK-*))))
# -O1: these headers take half as long to compile, and the mesher runs as fast.

$(call objects,$(IMAGE_SRC)): BASE_CXXFLAGS += $(if $(filter release,$(config)),-O1 -g1) -isystem $(firstword $(wildcard /usr/include/ITK-*) /usr/include/ITK)
$(call objects,apps/image/dicom.cpp): BASE_CXXFLAGS += -isystem $(firstword $(wildcard /usr/include/gdcm-*) /usr/include/gdcm)
# CGAL's own: a warning of its header repair_self_intersections.h
$(call objects,apps/image/surface.cpp): BASE_CXXFLAGS += -Wno-maybe-uninitialized
$(IMAGE_SO): $(call objects,$(IMAGE_SRC))
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CXX) $(SAN) -shared -o $@ $^ $(ITK_LIBS) -lgdcmMSFF -lgdcmDSED -lgdcmDICT -lgdcmCommon -lz -lgmp -lmpfr -lm

.PHONY: image
#: make image                  the module of tm-mesh image (ITK, CGAL: 47 MB of packages, installed if missing)
image:
	@tools/setup.sh build image
	@$(MAKE) --no-print-directory $(IMAGE_SO)
