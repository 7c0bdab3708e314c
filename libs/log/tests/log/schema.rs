//! Schemas in a log. External scripts read these fields by name: a change here breaks them.

use hapfic_log::Topic;
use hapfic_log::proto::DESCRIPTORS;
use prost::Message;
use prost_types::{DescriptorProto, FileDescriptorSet};

fn find(set: &FileDescriptorSet, full_name: &str) -> Option<DescriptorProto> {
    set.file.iter().find_map(|file| {
        let name = full_name.strip_prefix(file.package())?.strip_prefix('.')?;
        file.message_type.iter().find(|message| message.name() == name).cloned()
    })
}

fn fields(full_name: &str) -> String {
    let set = FileDescriptorSet::decode(DESCRIPTORS).unwrap();
    let message = find(&set, full_name).unwrap_or_else(|| panic!("no message {full_name}"));
    message.field.iter().map(|field| field.name()).collect::<Vec<_>>().join(" ")
}

#[test]
fn schema_of_every_topic_contains_its_message() {
    for topic in Topic::ALL {
        let set = FileDescriptorSet::decode(&*topic.schema()).unwrap();
        assert!(find(&set, topic.schema_name()).is_some(), "{} lacks {}", topic.name(), topic.schema_name());
        assert_eq!(Topic::from_name(topic.name()), Some(topic));
        assert_eq!(Topic::resolve(topic.name(), topic.schema_name()), Some(topic));
        let by_schema = if topic == Topic::StandbyRequest { Topic::Request } else { topic };
        assert_eq!(Topic::from_schema_name(topic.schema_name()), Some(by_schema));
        assert_eq!(Topic::resolve("/elsewhere", topic.schema_name()), Some(by_schema));
    }
    assert_eq!(Topic::resolve("/state", "hapfic.Request"), Some(Topic::Request));
    assert_eq!(Topic::resolve("/state", "other.Message"), None);
}

#[test]
fn topic_numbers_are_fixed() {
    // The recovery of a log without its first chunk relies on them: new topics come last.
    let names = Topic::ALL.map(Topic::name).join(" ");
    assert_eq!(names, "/state /reference /request /command /operator /event /timing /tf /scene /log /request/standby");
}

#[test]
fn field_names_are_fixed() {
    let expected = [
        (
            "hapfic.State",
            "tick time_ns joint_position joint_velocity joint_torque foot_position foot_velocity foot_force command_tick \
             wake_lateness_ns objects slipped drive contacts physics foot_orientation foot_angular_velocity foot_moment",
        ),
        ("hapfic.Object", "name position orientation linear_velocity angular_velocity"),
        ("hapfic.Contact", "body against point force depth"),
        (
            "hapfic.Physics",
            "substeps newton_iterations unconverged energy_j contact_work_j contact_stored_j contact_substeps joint_work_j joint_loss_j energy_error_j cut_substeps passages passed_body passed_against",
        ),
        ("hapfic.Reference", "tick position velocity parameters_version planner orientation angular_velocity"),
        ("hapfic.PlannerState", "ticks axes rotation_ticks target_rpy rotation_axes"),
        (
            "hapfic.Request",
            "tick state_tick controller parameters_version error error_rate offset x_max converging force torque at_rest_ticks \
             taper rotation_error rotation_error_rate moment rotation_offset joint_space_torque",
        ),
        (
            "hapfic.Command",
            "tick torque_raw torque controller mode state_tick parameters_version error error_rate offset x_max converging \
             force source severity limited at_rest_ticks ramped taper rate_limited rotation_error rotation_error_rate moment rotation_offset joint_space_torque",
        ),
        (
            "hapfic.Operator",
            "version effective_tick target_position desired_force stiffness max_force position_bound reset_policy \
             saturation search taper mean_speed search_scale force_resolution max_acceleration gravity_compensation \
             offset_anti_windup stall_release force_hold continuous_reentry damping posture_lead task target_orientation desired_moment rotation_stiffness max_moment \
             rotation_bound rotation_damping moment_resolution mean_turn_speed max_turn_acceleration posture posture_stiffness \
             posture_damping joint_damping limit_margin limit_stiffness",
        ),
        ("hapfic.Event", "tick process kind severity detector text"),
        (
            "hapfic.Timing",
            "tick process phase due_ns wake_ns publish_ns latency_ns wake_lateness_ns allocations rejected page_faults generation",
        ),
    ];
    for (message, names) in expected {
        assert_eq!(fields(message), names, "{message}");
    }
}

#[test]
fn schema_has_no_source_positions() {
    let set = FileDescriptorSet::decode(DESCRIPTORS).unwrap();
    assert!(set.file.iter().all(|file| file.source_code_info.is_none()));
}
