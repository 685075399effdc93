// SPDX-License-Identifier: Apache-2.0
// Uploads images through pinned memory, and keeps as many as fit the budget.
#include "kernels/engines/images_cuda.h"

#include <algorithm>
#include <cstring>

namespace gs {

unsigned char* PinnedBuffer::reserve(std::size_t bytes) {
    if (bytes > bytes_) {
        cudaFreeHost(data_);
        data_ = nullptr, bytes_ = 0;
        GS_CUDA(cudaMallocHost(&data_, bytes));
        bytes_ = bytes;
    }
    return data_;
}

CudaImages::CudaImages(std::int64_t budget, int slots) : budget_(budget) {
    GS_CUDA(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking));
    for (int k = 0; k < slots; ++k) {
        slots_.push_back(std::make_unique<Slot>());
        GS_CUDA(cudaEventCreateWithFlags(&slots_.back()->uploaded, cudaEventDisableTiming));
    }
}

CudaImages::~CudaImages() {
    for (auto& slot : slots_) cudaEventDestroy(slot->uploaded);
    cudaStreamDestroy(stream_);
}

std::int64_t CudaImages::slot_bytes() const {
    std::int64_t sum = 0;
    for (const auto& slot : slots_) sum += slot->device.bytes();
    return sum;
}

CudaImages::BorrowedMemory::BorrowedMemory(CudaImages& images, std::int64_t bytes) : images_(images) {
    auto& kept = images.kept_;
    std::int64_t in_flight = 0;  // an image that is not kept needs memory, too
    for (const auto& [id, image] : kept) in_flight = std::max(in_flight, image->memory.bytes());
    images.budget_now_ = std::max<std::int64_t>(0, images.kept_bytes_ - bytes - in_flight);
    for (auto image = kept.begin(); images.kept_bytes_ > images.budget_now_; image = kept.erase(image))
        images.kept_bytes_ -= image->second->memory.bytes();
}

DeviceTarget CudaImages::get(const TargetImage& t, int slot_number, cudaStream_t stream) {
    if (const auto at = kept_.find(t.id); t.id.is_known() && at != kept_.end()) return at->second->target;
    const std::size_t pixels = std::size_t(t.width) * t.height, values = pixels * t.channels;
    const std::size_t color_bytes = values * (t.u8 ? 1 : 4), mask_at = (color_bytes + 255) / 256 * 256,
                      bytes = t.mask ? mask_at + pixels : color_bytes;
    Slot& slot = *slots_[slot_number];
    unsigned char* host = slot.pinned.reserve(bytes);
    std::memcpy(host, t.u8 ? static_cast<const void*>(t.u8) : t.f32, color_bytes);
    DeviceTarget out{t, double(pixels)};
    if (t.mask) {
        std::memcpy(host + mask_at, t.mask, pixels);
        out.weight_sum = 0;
        for (std::size_t i = 0; i < pixels; ++i) out.weight_sum += t.mask[i] / 255.0;
    }
    unsigned char* device = nullptr;
    std::unique_ptr<Kept> kept;
    if (t.id.is_known() && kept_bytes_ + std::int64_t(bytes) <= budget_now_) {
        kept = std::make_unique<Kept>();
        try {
            device = kept->memory.reserve(bytes);
        } catch (const DeviceError&) {  // training works without kept images; from now on they are uploaded
            kept.reset();
            budget_ = budget_now_ = kept_bytes_;
        }
    }
    if (!device) device = slot.device.reserve(bytes);
    GS_CUDA(cudaMemcpyAsync(device, host, bytes, cudaMemcpyHostToDevice, stream_));
    GS_CUDA(cudaEventRecord(slot.uploaded, stream_));
    GS_CUDA(cudaStreamWaitEvent(stream, slot.uploaded));
    if (t.u8)
        out.image.u8 = device;
    else
        out.image.f32 = reinterpret_cast<const float*>(device);
    if (t.mask) out.image.mask = device + mask_at;
    if (kept) {
        kept->target = out;
        kept_bytes_ += std::int64_t(bytes);
        kept_[t.id] = std::move(kept);
    }
    return out;
}

}  // namespace gs
