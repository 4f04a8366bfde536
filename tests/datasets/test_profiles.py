from datasets.options import RecordingOptions
from datasets.rosbag.topics import with_profile

TOPICS = ("/tilt_scan", "/base_scan", "/base_odometry/odom", "/robot_pose_ekf/odom_combined", "/tf")


def test_auto_changes_nothing():
    assert with_profile(RecordingOptions(), TOPICS) == RecordingOptions()


def test_stata_names_what_it_knows():
    options = with_profile(RecordingOptions(profile="stata"), TOPICS)
    assert (options.scan_topic, options.odometry_topic) == ("/base_scan", "/robot_pose_ekf/odom_combined")
    assert (options.odom_frame, options.robot_frame) == ("odom_combined", "base_footprint")


def test_stata_without_its_topics_still_never_takes_the_nodding_laser():
    options = with_profile(RecordingOptions(profile="stata"), ("/tilt_scan",))
    assert (options.scan_topic, options.odometry_topic) == ("/base_scan", None)


def test_names_may_lack_the_slash_or_have_a_namespace():
    assert with_profile(RecordingOptions(profile="stata"), ("base_scan",)).scan_topic == "base_scan"
    assert with_profile(RecordingOptions(profile="stata"), ("/pr2/base_scan",)).scan_topic == "/pr2/base_scan"


def test_what_is_asked_for_stays():
    asked = RecordingOptions(
        profile="stata", scan_topic="/x", odom_frame="odom", robot_frame="base", odometry_topic="/y"
    )
    assert with_profile(asked, TOPICS) == asked
