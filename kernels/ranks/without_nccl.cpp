// SPDX-License-Identifier: Apache-2.0
// Replaces NCCL in builds that found no nccl.h. Other builds do not compile this file.
#include "kernels/base/error.h"
#include "kernels/ranks/connect_devices.h"

namespace gs {

NcclFinding find_nccl() {
    return {"", "", "this gsapp was built without NCCL; build it where nccl.h is found (libnccl-dev)"};
}
NcclId make_nccl_id() { throw DeviceError(find_nccl().why_not); }
std::unique_ptr<DeviceLink> connect_by_nccl(const Communicator&, const NcclId&) {
    throw DeviceError(find_nccl().why_not);
}

}  // namespace gs
