// Whole OpenVDB leaf buffers in and out as arrays.
#include <nanobind/nanobind.h>
#include <openvdb/openvdb.h>

namespace nb = nanobind;

NB_MODULE(_openvdb, module) {
    openvdb::initialize();
    module.attr("version") = openvdb::getLibraryAbiVersionString();
}
