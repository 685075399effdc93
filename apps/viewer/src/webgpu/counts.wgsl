// SPDX-License-Identifier: Apache-2.0
// What follows from how many Gaussians are in the view: arguments of draws and dispatches that the device starts by itself.

struct Counts {
    corners: u32, instances: u32, first_corner: u32, first_instance: u32,
    sort_groups: vec3u, visible: u32,
    color_groups: vec3u, unused: u32,
}
